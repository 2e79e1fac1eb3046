import{a,b,c}from"./chunk-2TL2ZQO4.js";import"./chunk-QM3DQEVC.js";import"./chunk-IZNNYOB3.js";export{c as Live,b as LiveFigures,a as WALL};
