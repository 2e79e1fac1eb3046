import{a,b,c}from"./chunk-HXVGXSSY.js";import"./chunk-B2MSXE6X.js";import"./chunk-DPTYE3YH.js";export{c as Live,b as LiveFigures,a as WALL};
