import{a,b,c}from"./chunk-W2IC2XZF.js";import"./chunk-VUOW3NUQ.js";import"./chunk-WBLWQLMZ.js";export{c as Live,b as LiveFigures,a as WALL};
