import{a,b,c}from"./chunk-3JAPGGI3.js";import"./chunk-AVUTNJAX.js";import"./chunk-6SZWMBOV.js";export{c as Live,b as LiveFigures,a as WALL};
